"""Constructive solid geometry: modelling language, exact ray caster with ground truth, model features, renderer node."""
