"""Stegagno et al. 2013: identities of anonymous positions, from odometry that the robots send."""
