"""The one error of every codec."""


class CodecError(ValueError):
    """A message that cannot be decoded, or a value that cannot be encoded. Starts with the field's name."""
