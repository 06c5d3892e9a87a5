"""S. Y. Choi, Georgia Institute of Technology 2016: balancing of `astros` by sliding masses."""
