"""What needs measurements: virtual ones, calibration, correction."""
