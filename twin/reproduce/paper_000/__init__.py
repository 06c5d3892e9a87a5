"""Batch identification and adaptive balancing with control moment gyros, on `tas2`."""
