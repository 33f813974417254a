"""Functional mock-up units: their variables, descriptions, sources and archives."""
