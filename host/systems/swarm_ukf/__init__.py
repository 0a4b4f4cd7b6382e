"""Miller 2019: the poses of a whole swarm at one place, from who sees whom where."""
