"""Phase 1: joint centres, fitted once to a whole recording."""
