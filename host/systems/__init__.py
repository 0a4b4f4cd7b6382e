"""Localization systems of related works, for what a swarm can do with other parts than ours."""
