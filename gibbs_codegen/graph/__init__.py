"""The graph of a function's operations, with the passes that differentiate and shorten it."""
