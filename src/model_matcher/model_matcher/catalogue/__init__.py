"""Libraries of any size: an inverted index of pairs of features on disk, and which of its models a scene may show."""
