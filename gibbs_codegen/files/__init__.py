"""The disk: TOML with line numbers, templates, and folders that are written whole."""
