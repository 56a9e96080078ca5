"""Named numbers of the room bit_planes: the planes that keep results exact, and the one limit of its functions."""

from __future__ import annotations

# Planes below the fraction that make the rounding of a sum exact: one digit that normalising may bring up, the bit that
# decides the rounding, and one that is true where anything was lost below.
GUARD = 6
# Planes below the last place of an elementary function: they hold the truncations of as many steps as there are planes,
# less than 2^8, and make what is left of them less than a hundredth of the last place.
SPARE = 16
# Further planes of a REAL for functions that are made of others: as SPARE, and the seven binary places that the power
# loses between logarithm and exponential, whose argument is below 2^8. A whole number of digits.
LONGER = 12
# Digits before the point of the angles that SIN, COS and TAN take: from 16^5 on they are refused, because every element
# needs the planes of the largest angle.
ANGLE_DIGITS = 5
# Binary places of constants beyond those asked for, which hold the rounding of their series: less than 2^8 terms.
SERIES_SPARE = 32
