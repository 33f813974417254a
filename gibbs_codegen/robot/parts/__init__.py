"""What a robot is made of: a part is one class, whose fields are the keys of its table."""
