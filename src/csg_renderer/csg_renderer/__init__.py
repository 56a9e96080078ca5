"""Constructive solid geometry: modelling language, exact ray caster, model features, renderer node."""
