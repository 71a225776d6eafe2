"""What all rooms need, and no user."""
