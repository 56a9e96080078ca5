"""Folders from which files may be opened, under the name that users know."""

from .node_runtime.confinement import TrustedFolders

__all__ = ['TrustedFolders']
