"""What is fitted of a machine beside its effects: J, m r and what joints take."""
