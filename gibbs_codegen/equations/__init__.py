"""The paper's equations in print: what `show` and the closed forms need."""
