"""The two papers that the project comes from, reproduced: equations, tables, and what differs from the print."""
