"""An array program as an image filter: a grey image in, a grey image out."""

from __future__ import annotations

import numpy as np

from ..fortran_plus import Limits
from ..fortran_plus.library import load_program
from ..machine.dap import Dap


class ImageProgram:
    """A program whose entry has one matrix it reads, IMAGE, and one matrix it leaves its answer in, RESULT.

    name : library program or file; entry : '' for the only one; model : of the machine
    Raises ValueError when the entry lacks those arguments.
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
        if types['IMAGE'].kind.name == 'INTEGER' and types['IMAGE'].kind.bits < 16:
            raise ValueError(f'{name}: IMAGE is {types["IMAGE"].kind}; grey values 0..255 need INTEGER*2 or REAL')
        self._real = types['IMAGE'].kind.name == 'REAL'

    def run(self, image: np.ndarray, seconds: float | None = None) -> np.ndarray:
        """(h, w) uint8 to (h, w) uint8: LOGICAL becomes 0 or 255, numbers are cut to 0..255. Raises FortranError."""
        dap = Dap.model(self.model, tracing=False)
        given = image.astype(np.float32 if self._real else np.int16)
        result = self.program.run(dap, self.entry.unit.name, limits=Limits(seconds=seconds), image=given)
        self.cycles, self.seconds = result.cycles, result.seconds
        out = result['RESULT']
        if out.dtype == bool:
            return np.where(out, np.uint8(255), np.uint8(0))
        return np.clip(np.nan_to_num(out), 0, 255).astype(np.uint8)
