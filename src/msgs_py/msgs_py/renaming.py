"""Old names that go on working and say so, under the name that users know."""

from .node_runtime.renaming import notice, renamed_arguments, renamed_names, without_effect

__all__ = ['notice', 'renamed_arguments', 'renamed_names', 'without_effect']
