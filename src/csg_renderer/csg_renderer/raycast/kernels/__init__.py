"""Compiled inner loops of the native engine."""
