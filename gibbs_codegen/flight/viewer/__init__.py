"""Robots and flights in the browser, drawn by viser: live, or as one file without requests."""
