"""Effects of the catalogue as forces and columns of a prediction."""
