"""All there is to say stands in setup.cfg; colcon and older tools look for this file."""

from setuptools import setup

setup()
