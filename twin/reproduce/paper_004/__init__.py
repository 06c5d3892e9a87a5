"""Mass properties identification and automatic mass balancing system (Sharifi and others, 2019)."""
