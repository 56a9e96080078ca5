"""What all tests share: a profile of hypothesis for runs that look for what nobody has seen (make fresh-seeds)."""

from hypothesis import settings

settings.register_profile('many', max_examples=1000, deadline=None)
