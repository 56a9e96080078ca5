"""An array program as an image filter: a grey image in, a grey image out."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray, ByteArray

from ..fortran_plus import Limits
from ..fortran_plus.library import load_program
from ..machine.dap import Dap
from .settings import GREY_VALUE_BITS


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

    def run(self, image: ByteArray, seconds: float | None = None) -> ByteArray:
        """Filter an image.

        Parameters
        ----------
        image : (h, w) uint8 array
            Grey values.
        seconds : float, optional
            The run is stopped after this time.

        Returns
        -------
        (h, w) uint8 array
            0 or 255 for LOGICAL; numbers are cut to 0..255.

        Raises
        ------
        FortranError
            When the program fails.
        Stopped
            When the time is over.
        """
        dap = Dap.model(self.model, tracing=False)
        given = image.astype(np.float32 if self._real else np.int16)
        result = self.program.run(dap, self.entry.unit.name, limits=Limits(seconds=seconds), image=given)
        self.cycles, self.seconds = result.cycles, result.seconds
        out: AnyArray = result['RESULT']
        if out.dtype == bool:
            return np.where(out, np.uint8(255), np.uint8(0))
        grey: ByteArray = np.clip(np.nan_to_num(out), 0, 255).astype(np.uint8)
        return grey
