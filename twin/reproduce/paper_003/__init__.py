"""Balancing in the plane by sliding masses with and without magnetorquers, on `cubesat`."""
