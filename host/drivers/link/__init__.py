"""The link between robots: each sends its odometry, signed, to all."""
