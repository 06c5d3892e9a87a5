"""Thousands of closed-loop runs that differ as a specification says."""
