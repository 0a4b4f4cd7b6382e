"""Experiments: the papers' figures for any source, results folders, sweeps."""
