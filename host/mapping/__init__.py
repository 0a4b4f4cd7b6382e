"""A map of the room, without the teammates that drove through it (Belaroussi 2024, appendix B)."""
