"""Log + platform + parameters -> whitened innovations and their columns, in batches."""
