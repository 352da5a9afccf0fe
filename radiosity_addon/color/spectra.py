# SPDX-License-Identifier: GPL-3.0-or-later
"""Spectra and what the eye makes of them: tristimulus values, black bodies, daylight, dominant wavelength."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Floats
from .spaces import D65, RGBSpace, xy_of, xyz_of
from .tables import DAYLIGHT, OBSERVER

WAVELENGTHS = OBSERVER[:, 0]
"""(95,), nm, of the observer and of all spectra here."""
SECOND_RADIATION_CONSTANT = 1.438776877e-2
"""h c / k, m K (SI 2019, CODATA 2018)."""


def observer(wavelength: Floats | float) -> Float64:
    """Colour matching functions x, y, z (..., 3) of the CIE 1931 2 degree observer at wavelengths (...), nm.

    Linear between the published 5 nm, zero outside of 360 to 830 nm.
    """
    at = np.asarray(wavelength, np.float64)
    columns = [np.interp(at, WAVELENGTHS, OBSERVER[:, column], left=0.0, right=0.0) for column in (1, 2, 3)]
    return np.stack(columns, axis=-1)


def spectrum_to_xyz(wavelength: Floats, density: Floats) -> Float64:
    """XYZ (..., 3), not scaled, of spectra: the sum over 5 nm of density times colour matching functions.

    Args:
        wavelength: (K,), nm, rising
        density: (..., K), power per nm; zero outside of the wavelengths given
    """
    rows = np.asarray(density, np.float64).reshape(-1, len(wavelength))
    on_grid = np.array([np.interp(WAVELENGTHS, wavelength, row, left=0.0, right=0.0) for row in rows])
    xyz: Float64 = 5.0 * on_grid @ OBSERVER[:, 1:]
    return xyz.reshape(*np.shape(density)[:-1], 3)


def planck(wavelength: Floats, kelvin: Floats | float) -> Float64:
    """Spectral density (..., K) of black bodies (...), K, at wavelengths (K,), nm, as shares of that at 560 nm."""
    temperature = np.asarray(kelvin, np.float64)[..., None]
    metres = np.asarray(wavelength, np.float64) * 1e-9

    def per_wavelength(at: Floats) -> Float64:
        exponent = SECOND_RADIATION_CONSTANT / (at * temperature)
        return -5 * np.log(at) - exponent - np.log1p(-np.exp(-exponent))

    return np.exp(per_wavelength(metres) - per_wavelength(np.array([560e-9])))


def blackbody_xy(kelvin: Floats | float) -> Float64:
    """Chromaticity (..., 2) of black bodies at temperatures (...), K: the Planckian locus."""
    return xy_of(spectrum_to_xyz(WAVELENGTHS, planck(WAVELENGTHS, kelvin)))


def blackbody(kelvin: Floats | float, space: RGBSpace) -> Float64:
    """Linear RGB (..., 3), of luminance 1, of black bodies at temperatures (...), K; red ones may lie outside.

    Blender's lamps and Blackbody nodes take a polynomial fit of the same curve, with negative channels cut off.
    """
    rgb: Float64 = xyz_of(blackbody_xy(kelvin)) @ space.from_xyz.T
    return rgb


def daylight(kelvin: float) -> Float64:
    """Relative spectral density (95,) of daylight at a colour temperature, 4000 to 25000 K (CIE 15:2004, section 3.1).

    D65 is daylight(6500 * 1.4388 / 1.4380), by the constant of Planck's law at the time, likewise the others.
    """
    t = 1e3 / kelvin
    x = (
        0.244063 + (0.09911 + (2.9678 - 4.6070 * t) * t) * t
        if kelvin <= 7000
        else 0.237040 + (0.24748 + (1.9018 - 2.0064 * t) * t) * t
    )
    y = -3.000 * x**2 + 2.870 * x - 0.275
    below = 0.0241 + 0.2562 * x - 0.7341 * y
    first = round((-1.3515 - 1.7703 * x + 5.9114 * y) / below, 3)
    second = round((0.0300 - 31.4424 * x + 30.0717 * y) / below, 3)
    mean = DAYLIGHT[:, 1] + first * DAYLIGHT[:, 2] + second * DAYLIGHT[:, 3]
    return np.interp(WAVELENGTHS, DAYLIGHT[:, 0], mean)


ILLUMINANTS = {
    "A": planck(WAVELENGTHS, 2848 * SECOND_RADIATION_CONSTANT / 1.435e-2),
    "D50": daylight(5000 * 1.4388 / 1.4380),
    "D65": daylight(6500 * 1.4388 / 1.4380),
}
"""Relative spectral densities (95,) of the CIE's standard illuminants, 1 or 100 at 560 nm."""


def dominant_wavelength(xy: Floats, white: tuple[float, float] = D65) -> tuple[Float64, Float64]:
    """Hue and saturation of chromaticities (..., 2) as those of a spectral colour mixed with white.

    Returns:
        wavelength: (...), nm, where the ray from white through the colour meets the spectral locus; of purples, whose
            ray meets the line between its ends, the wavelength on the other side, negative; nan for white itself
        purity: (...), excitation purity: the colour's share of the way from white to the boundary, on its own side
    """
    start = np.array(white)
    locus = xy_of(OBSERVER[(WAVELENGTHS >= 380) & (WAVELENGTHS <= 700), 1:])
    known = WAVELENGTHS[(WAVELENGTHS >= 380) & (WAVELENGTHS <= 700)]
    way = np.asarray(xy, np.float64) - start
    flat = way.reshape(-1, 2)
    ahead, reach = _meet(start, flat, locus, known)
    behind, _ = _meet(start, -flat, locus, known)
    closing = _meet(start, flat, locus[[-1, 0]], np.zeros(2))[1]
    purple = np.isnan(ahead)
    wavelength = np.where(purple, -behind, ahead)
    with np.errstate(divide="ignore", invalid="ignore"):
        purity = np.where(flat.any(-1), 1 / np.where(purple, closing, reach), 0.0)
    return wavelength.reshape(way.shape[:-1]), purity.reshape(way.shape[:-1])


def _meet(start: Float64, way: Float64, line: Float64, values: Float64) -> tuple[Float64, Float64]:
    """Where rays start + t way (N, 2) first meet a polyline (K, 2): its values (K,) there and t, or nan."""
    edge, offset = np.diff(line, axis=0), line[:-1] - start
    cross = way[:, None, 0] * edge[:, 1] - way[:, None, 1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (offset[:, 0] * edge[:, 1] - offset[:, 1] * edge[:, 0]) / cross
        share = (offset[:, 0] * way[:, None, 1] - offset[:, 1] * way[:, None, 0]) / cross
    met = (t > 0) & (share >= 0) & (share <= 1)
    first = np.where(met, t, np.inf).argmin(axis=1)
    row = np.arange(len(way))
    found = met[row, first]
    value = values[first] + share[row, first] * np.diff(values)[first]
    return np.where(found, value, np.nan), np.where(found, t[row, first], np.nan)
