"""A machine carried along a log under its drives, and how small changes are carried on with it."""
