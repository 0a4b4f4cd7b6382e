"""Miller 2019: the poses of a whole swarm in one filter, from identified sightings."""
