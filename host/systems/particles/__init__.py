"""Lee 2012: one intruder or teammate, from its distances to robots whose places are known."""
