"""What tests share: random robots, oracles, emitted modules, programs that are run."""
