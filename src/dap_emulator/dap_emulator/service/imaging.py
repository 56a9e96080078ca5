"""An array program as an image filter: a grey image in, a grey image out."""

from __future__ import annotations

import threading

import numpy as np

from msgs_py.numeric.typed import AnyArray, ByteArray

from ..fortran_plus.library import load_program
from .processes import PROCESSES
from .program_worker import RunJob
from .settings import GREY_VALUE_BITS, LARGEST_IMAGE_BYTES, RUN_SECONDS


class ImageProgram:
    """A program whose entry reads a matrix IMAGE and leaves its answer in a matrix RESULT.

    Parameters
    ----------
    name : str
        Library program or file.
    entry : str
        Name of the ENTRY SUBROUTINE; empty for the only one.
    model : str
        Model of the machine.

    Attributes
    ----------
    cycles : int
    seconds : float
        Cost of the last image on the machine: computed, not simulated.

    Raises
    ------
    ValueError
        When the entry lacks those arguments, or the program cannot be compiled.
    OSError
        When the file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.zeros((8, 8), np.uint8)
    >>> image[:, 4:] = 100
    >>> ImageProgram('roberts').run(image)[3].tolist()
    [0, 0, 0, 141, 0, 0, 0, 141]
    """

    def __init__(self, name: str, entry: str = '', model: str = '510') -> None:
        self.settings = (name, entry, model)
        self.program = load_program(name)
        self.entry = self.program.entry(entry or None)
        self.model = model
        self.cycles, self.seconds = 0, 0.0
        types = {symbol.name: symbol.type for symbol in self.entry.arguments}
        for wanted in ('IMAGE', 'RESULT'):
            if wanted not in types or types[wanted].rank != 2 or types[wanted].serial:
                raise ValueError(f'{name}: the entry {self.entry.unit.name} has no matrix {wanted}')
        if types['IMAGE'].kind.name == 'INTEGER' and types['IMAGE'].kind.bits < GREY_VALUE_BITS:
            raise ValueError(f'{name}: IMAGE is {types["IMAGE"].kind}; grey values 0..255 need INTEGER*2 or REAL')
        self._real = types['IMAGE'].kind.name == 'REAL'

    def run(
        self, image: ByteArray, seconds: float = RUN_SECONDS, cancelled: threading.Event | None = None
    ) -> ByteArray:
        """Filter an image, in a process of its own.

        Parameters
        ----------
        image : (h, w) uint8 array
            Grey values.
        seconds : float
            The run is stopped after this time.
        cancelled : threading.Event, optional
            Stops the run when another thread sets it.

        Returns
        -------
        (h, w) uint8 array
            0 or 255 for LOGICAL; numbers are cut to 0..255.

        Raises
        ------
        ProgramFailed
            When the program fails.
        Stopped
            When the time is over, or the run was cancelled.
        """
        given = {'image': image.astype(np.float32 if self._real else np.int16)}
        source = self.program.source
        answer = PROCESSES.run(
            RunJob(source, self.entry.unit.name, self.model, given, seconds, LARGEST_IMAGE_BYTES), cancelled
        )
        self.cycles, self.seconds = answer.stats.cycles, answer.stats.seconds
        out: AnyArray = answer.values['RESULT']
        if out.dtype == bool:
            return np.where(out, np.uint8(255), np.uint8(0))
        grey: ByteArray = np.clip(np.nan_to_num(out), 0, 255).astype(np.uint8)
        return grey
