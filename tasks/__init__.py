"""Stages: thin, cached shells round the science functions."""
