"""Effects on the gimbals of control moment gyros."""
