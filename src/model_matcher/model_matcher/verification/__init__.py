"""Whether a pose is right: refinement, line of sight, evidence, acceptance."""
