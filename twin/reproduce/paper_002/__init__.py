"""System identification of a spherical air-bearing spacecraft simulator (AAS 04-122)."""
