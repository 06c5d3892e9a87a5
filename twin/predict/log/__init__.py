"""What a log says by itself: how the base moves, noise, ranges, scales, stated errors."""
