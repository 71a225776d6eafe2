"""Records of an arm: read from a file or simulated, and what they say of where the tip was."""
