"""Parts of robots: a part is one class, whose fields are the keys of its table."""
