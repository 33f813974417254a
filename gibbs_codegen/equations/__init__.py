"""The paper's equations in print, for `show` and the closed forms."""
