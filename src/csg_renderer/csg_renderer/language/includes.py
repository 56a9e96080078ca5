"""Files that a scene names: which one a path means, which may be read, and no file inside itself."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from msgs_py.numeric.typed import Float32Array

from ..scene.height_files import HeightGrid, read_heights
from ..scene.textures import ENVIRONMENT_SUFFIXES, TEXTURE_SUFFIXES, read_picture
from .parser import Source
from .settings import MAX_CHARACTERS, MAX_DEPTH, MAX_FILES, MAX_SCENE_HEIGHTS, MAX_SCENE_TEXELS

Read = TypeVar('Read')


def models_folder() -> Path:
    """The folder of scenes and models that comes with this package."""
    return Path(str(files('csg_renderer').joinpath('models')))


def read_source(path: Path, shown: str) -> Source:
    """A file's text. Raises ValueError with a message for the user."""
    try:
        if path.stat().st_size > MAX_CHARACTERS:
            raise ValueError(f'{shown!r} is larger than {MAX_CHARACTERS} bytes')
        return Source(path.read_bytes().decode('utf-8-sig').replace('\r\n', '\n'), shown)
    except UnicodeDecodeError:
        raise ValueError(f'{shown!r} is no text file (expected UTF-8)') from None
    except OSError as error:
        raise ValueError(f'{shown!r} cannot be read: {error.strerror or error}') from None


class Includes:
    """The files one scene is made of. A path is looked up beside the including file, then among the package's models.

    root : files must lie in this folder or below it (or among the package's models); None allows those only.
    """

    def __init__(self, root: Path | None, first: Path | None = None) -> None:
        self.root = root.resolve() if root is not None else None
        self.read: list[Path] = [first.resolve()] if first is not None else []
        self.open_files: list[Path] = list(self.read)
        self.done: dict[Path, Any] = {}
        self.grids: dict[Path, HeightGrid] = {}
        self.height_count = 0
        self.pictures: dict[Path, Float32Array] = {}

    def open(self, written: str, includer: Path | None) -> tuple[Source, Path]:
        """The source of an included file. Raises ValueError with a message for the user."""
        path = self._find(written, includer)
        if path in self.open_files:
            chain = ' -> '.join(p.name for p in [*self.open_files[self.open_files.index(path) :], path])
            raise ValueError(f'these files include each other: {chain}')
        if len(self.open_files) > MAX_DEPTH or len(self.read) > MAX_FILES:
            raise ValueError(f'more than {MAX_DEPTH} files inside each other or {MAX_FILES} in all')
        source = read_source(path, str(path) if not path.is_relative_to(models_folder()) else path.name)
        self.read.append(path)
        self.open_files.append(path)
        return source, path

    def close(self, path: Path, names: dict[str, Any]) -> None:
        """The file is evaluated; a second INCLUDE of it will find its names here."""
        self.open_files.remove(path)
        self.done[path] = names

    def heights(self, written: str, includer: Path | None) -> tuple[HeightGrid, str]:
        """The heights of a file, and its path from the root. Raises ValueError with a message for the user."""
        path = self._find(written, includer, 'TERRAIN')
        if path not in self.grids:
            self.grids[path] = self._read(read_heights, path, written)
        grid = self.grids[path]
        self.height_count += grid.heights.size
        if self.height_count > MAX_SCENE_HEIGHTS:
            raise ValueError(f'the terrains of this scene have more than {MAX_SCENE_HEIGHTS} heights')
        return grid, self._from_root(path)

    def picture(self, written: str, includer: Path | None, word: str) -> tuple[Float32Array, str]:
        """The picture of a TEXTURE or ENVIRONMENT, and its path from the root. Raises ValueError for the user."""
        path = self._find(written, includer, word)
        if path not in self.pictures:
            suffixes = ENVIRONMENT_SUFFIXES if word == 'ENVIRONMENT' else TEXTURE_SUFFIXES
            picture = self._read(partial(read_picture, suffixes=suffixes), path, written)
            picture.flags.writeable = False
            self.pictures[path] = picture
        if sum(picture.size // 3 for picture in self.pictures.values()) > MAX_SCENE_TEXELS:
            raise ValueError(f'the pictures of this scene have more than {MAX_SCENE_TEXELS} pixels')
        return self.pictures[path], self._from_root(path)

    def _read(self, reader: Callable[[Path], Read], path: Path, written: str) -> Read:
        """What a file holds. What is wrong with it is told under the name that was written."""
        if len(self.read) > MAX_FILES:
            raise ValueError(f'more than {MAX_FILES} files')
        try:
            found = reader(path)
        except (ValueError, OSError) as error:
            raise ValueError(f'{written}: {str(error).removeprefix(f"{path}: ")}') from None
        self.read.append(path)
        return found

    def _from_root(self, path: Path) -> str:
        folder = next(folder for folder in self._roots() if path.is_relative_to(folder))
        return path.relative_to(folder).as_posix()

    def known(self, written: str, includer: Path | None) -> Any | None:
        """The names of a file that was included before, or None."""
        return self.done.get(self._find(written, includer))

    def _roots(self) -> list[Path]:
        return [folder.resolve() for folder in (self.root, models_folder()) if folder is not None]

    def _find(self, written: str, includer: Path | None, word: str = 'INCLUDE') -> Path:
        if not written.strip() or '\0' in written:
            raise ValueError(f'{word} needs a file name')
        roots = self._roots()
        beside = includer.parent if includer is not None else self.root
        outside = False
        for folder in (beside, models_folder()):
            if folder is None:
                continue
            try:
                path = (folder / written).resolve()
                if not any(path.is_relative_to(root) for root in roots):
                    outside = True
                elif path.is_file():
                    return path
            except (OSError, RuntimeError):  # a name too long, a loop of links
                continue
        if outside:
            raise ValueError(f'{written!r} lies outside the folder of the scene')
        raise ValueError(f'there is no file {written!r} beside this file or among the models of the package')
