"""Source that stands in every generated module, whole and the same for every robot."""
