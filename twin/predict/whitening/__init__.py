"""The states taken out: white innovations and their columns."""
