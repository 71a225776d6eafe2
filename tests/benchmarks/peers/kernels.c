/* The plain loop that a C programmer writes for an arm in standard DH: the limit that this package is timed against.
 *
 * gcc -O3 -march=native -shared -fPIC kernels.c -o kernels.so -lm
 *
 * All arrays are in C order, SI units. rows is at most 16, a row being a, d, alpha, theta_offset; every row has a joint.
 */

#include <math.h>

enum { MOST_ROWS = 16 };

/* Position (n, 3) and its sensitivity (n, 3, 4 rows) to a, d, alpha, theta of every row, for q (n, rows). */
void sensitivities(long n, long rows, const double *table, const double *q, double *position, double *columns)
{
    double ca[MOST_ROWS], sa[MOST_ROWS];
    for (long i = 0; i < rows; i++) {
        ca[i] = cos(table[4 * i + 2]);
        sa[i] = sin(table[4 * i + 2]);
    }
    for (long k = 0; k < n; k++) {
        double frame[MOST_ROWS + 1][4][3] = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}}; /* x, y, z, origin */
        for (long i = 0; i < rows; i++) {
            const double a = table[4 * i], d = table[4 * i + 1];
            const double theta = q[k * rows + i] + table[4 * i + 3], c = cos(theta), s = sin(theta);
            for (int j = 0; j < 3; j++) {
                const double x = frame[i][0][j], y = frame[i][1][j], z = frame[i][2][j];
                const double turned = c * x + s * y, across = c * y - s * x;
                frame[i + 1][0][j] = turned;
                frame[i + 1][1][j] = ca[i] * across + sa[i] * z;
                frame[i + 1][2][j] = ca[i] * z - sa[i] * across;
                frame[i + 1][3][j] = frame[i][3][j] + d * z + a * turned;
            }
        }
        const double *p = frame[rows][3];
        double *out = columns + k * 12 * rows;
        for (int j = 0; j < 3; j++)
            position[3 * k + j] = p[j];
        for (long i = 0; i < rows; i++) {
            const double *x = frame[i + 1][0], *z = frame[i][2], *ox = frame[i + 1][3], *oz = frame[i][3];
            for (int j = 0; j < 3; j++) {
                const int u = (j + 1) % 3, v = (j + 2) % 3;
                double *column = out + 4 * rows * j + 4 * i;
                column[0] = x[j];
                column[1] = z[j];
                column[2] = x[u] * (p[v] - ox[v]) - x[v] * (p[u] - ox[u]);
                column[3] = z[u] * (p[v] - oz[v]) - z[v] * (p[u] - oz[u]);
            }
        }
    }
}

/* Volume (n,) of the zonotopes of generators (n, 3, p): eight times the sum of |det| over all triples. */
void volumes(long n, long p, const double *generators, double *volume)
{
    for (long k = 0; k < n; k++) {
        const double *x = generators + 3 * p * k, *y = x + p, *z = y + p;
        double sum = 0.0;
        for (long i = 0; i < p; i++)
            for (long j = i + 1; j < p; j++) {
                const double u = y[i] * z[j] - z[i] * y[j], v = z[i] * x[j] - x[i] * z[j], w = x[i] * y[j] - y[i] * x[j];
                for (long l = j + 1; l < p; l++)
                    sum += fabs(u * x[l] + v * y[l] + w * z[l]);
            }
        volume[k] = 8.0 * sum;
    }
}
