"""What a laboratory does with its machine before and after a session, behind the same guard."""
