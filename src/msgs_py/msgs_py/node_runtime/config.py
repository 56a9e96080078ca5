"""Node parameters as a frozen, validated dataclass. Pure: :mod:`msgs_py.runtime` turns it into ROS parameters.

A node's Config is one class whose fields are made with :func:`parameter`. Building one validates it, so a Config that
exists is usable; a changed parameter builds a new candidate and swaps it in whole.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from typing import Any, TypeVar

# What a parameter may be; the items of a tuple are of one of the other types.
Value = bool | int | float | str | tuple[Any, ...]

T = TypeVar('T', bound='Config')


@dataclass(frozen=True)
class ParameterSpec:
    """What a user is told of a parameter, and what is checked.

    Parameters
    ----------
    name : str
        Name of the ROS parameter.
    default : bool, int, float, str or tuple
        Its type is the parameter's.
    description : str
        One sentence for the user.
    unit : str
    minimum, maximum : float, optional
        Smallest and largest value of a number.
    choices : tuple
        The only values accepted; empty for any.
    read_only : bool
        Whether it is set when the node is started only.
    element : type
        Type of a tuple's items.
    formerly : tuple of str
        Old names, which a node accepts with a warning.

    Examples
    --------
    >>> sigma = ParameterSpec('sigma', 1.0, 'Width of the smoothing', unit='px', minimum=0.5, maximum=3.0)
    >>> sigma.check(2)
    2.0
    >>> sigma.check(4.0)
    Traceback (most recent call last):
    ValueError: parameter sigma: 4 is out of range, expected 0.5 to 3 px
    """

    name: str
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Any, ...] = ()
    read_only: bool = False
    element: type = str
    formerly: tuple[str, ...] = ()

    @property
    def kind(self) -> type:
        """The parameter's type."""
        return type(self.default)

    @property
    def range_text(self) -> str:
        """The accepted values in words, for descriptors, errors and the README's tables."""
        if self.choices:
            return 'one of ' + ', '.join(repr(choice) for choice in self.choices)
        if self.minimum is not None and self.maximum is not None:
            return f'{self.minimum:g} to {self.maximum:g}'
        if self.minimum is not None:
            return f'at least {self.minimum:g}'
        return f'at most {self.maximum:g}' if self.maximum is not None else ''

    def check(self, value: Any) -> Value:
        """A value in the parameter's own type.

        Raises
        ------
        ValueError
            Names the parameter and what was expected.
        """
        if self.kind is tuple:
            if isinstance(value, str | bytes) or not hasattr(value, '__iter__'):
                raise ValueError(f'parameter {self.name}: expected a list, got {value!r}')
            return tuple(self._check_one(item, self.element) for item in value)
        checked: Value = self._check_one(value, self.kind)
        return checked

    def _check_one(self, value: Any, kind: type) -> Any:
        accepted = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
        whole = kind is float and isinstance(value, int) and not isinstance(value, bool)
        if not (accepted or whole):  # "sigma:=2" is what people type
            raise ValueError(f'parameter {self.name}: expected {_TYPE_NAMES[kind]}, got {value!r}')
        if kind in (int, float):
            if not abs(value) <= sys.float_info.max:
                raise ValueError(f'parameter {self.name}: expected a finite number, got {value!s:.40}')
            value = float(value) if whole else value
            too_small = self.minimum is not None and value < self.minimum
            if too_small or (self.maximum is not None and value > self.maximum):
                unit = f' {self.unit}' if self.unit else ''
                raise ValueError(f'parameter {self.name}: {value:g} is out of range, expected {self.range_text}{unit}')
        if self.choices and value not in self.choices:
            raise ValueError(f'parameter {self.name}: {value!r} is unknown, expected {self.range_text}')
        return value


_TYPE_NAMES = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a string'}


def parameter(
    default: Any,
    description: str,
    *,
    name: str | None = None,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[Any, ...] = (),
    read_only: bool = False,
    element: type = str,
    formerly: tuple[str, ...] = (),
) -> Any:
    """A field of a Config; the arguments are those of :class:`ParameterSpec`.

    Parameters
    ----------
    name : str, optional
        Name of the ROS parameter, where it is not the field's.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Settings(Config):
    ...     threshold: float = parameter(0.5, 'Least contrast', minimum=0.0, formerly=('contrast',))
    >>> Settings.from_parameters({'threshold': 1})
    Settings(threshold=1.0)
    >>> Settings.former_names()
    {'contrast': 'threshold'}
    """
    return field(
        default=default,
        metadata={
            'spec': {
                'name': name,
                'default': default,
                'description': description,
                'unit': unit,
                'minimum': minimum,
                'maximum': maximum,
                'choices': choices,
                'read_only': read_only,
                'element': element,
                'formerly': formerly,
            }
        },
    )


@dataclass(frozen=True)
class Config:
    """Base of every node's configuration, a frozen dataclass whose fields are made with :func:`parameter`.

    Raises
    ------
    ValueError
        Names the parameter, when a value is not usable.
    """

    def __post_init__(self) -> None:
        for item, spec in _specs(type(self)):
            object.__setattr__(self, item.name, spec.check(getattr(self, item.name)))
        self.validate()

    def validate(self) -> None:
        """Rules that span parameters; raise ValueError naming them. Each parameter alone has been checked."""

    @classmethod
    def parameters(cls) -> tuple[ParameterSpec, ...]:
        """All parameters, in the order of the fields."""
        return tuple(spec for _, spec in _specs(cls))

    @classmethod
    def from_parameters(cls: type[T], values: Mapping[str, Any]) -> T:
        """The configuration with these values, by the names of ROS; what is missing takes its default.

        Raises
        ------
        ValueError
            For an unknown name or an unusable value.
        """
        return cls().changed(values)

    def changed(self: T, values: Mapping[str, Any]) -> T:
        """A copy with these parameters changed, by the names of ROS; raises as :meth:`from_parameters`."""
        fields_by_name = {spec.name: item.name for item, spec in _specs(type(self))}
        unknown = [name for name in values if name not in fields_by_name]
        if unknown:
            raise ValueError(f'parameter {unknown[0]}: unknown, expected one of {", ".join(sorted(fields_by_name))}')
        return replace(self, **{fields_by_name[name]: value for name, value in values.items()})

    @classmethod
    def former_names(cls) -> dict[str, str]:
        """Old names of parameters, and what they are called now."""
        return {old: spec.name for spec in cls.parameters() for old in spec.formerly}

    def as_parameters(self) -> dict[str, Value]:
        """The values by the names of ROS."""
        return {spec.name: getattr(self, item.name) for item, spec in _specs(type(self))}


def _specs(cls: type[Config]) -> list[tuple[Field[Any], ParameterSpec]]:
    """The fields of a Config and what is known of each."""
    pairs = []
    for item in fields(cls):
        if 'spec' not in item.metadata or item.default is MISSING:
            raise TypeError(f'{cls.__name__}.{item.name}: make it with parameter(default, description)')
        spec = dict(item.metadata['spec'])
        spec['name'] = spec['name'] or item.name
        pairs.append((item, ParameterSpec(**spec)))
    return pairs
