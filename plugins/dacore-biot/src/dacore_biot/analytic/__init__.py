"""Solutions of poroelasticity by formula: what a discrete model is measured against.

Nothing here is shared with the model: coefficients are derived anew in `medium.Medium`, along another
way than in `dacore_biot.material`. All are in cgs, loads and stresses are total, pressures are those in
excess of the state before the load. Series are summed until their terms vanish in double precision.

====================================  ===========================================================
`terzaghi.Terzaghi`                   a column loaded on its drained end (Terzaghi 1923)
`mandel.Mandel`                       a block between rigid plates (Mandel 1953)
`cryer.Cryer`                         a ball under pressure on its drained surface (Cryer 1963)
`uniform.drained`, `.undrained`       a body under a uniform stress, at once and in the end
`uniform.SunkColumn`                  a column under its own weight, before anything seeps
`wave.Wave`                           a pulse that runs through a bar and back, fast wave or dry
`harmonic.Column`                     a column shaken at one frequency (Zienkiewicz et al. 1980)
====================================  ===========================================================
"""

from dacore_biot.analytic.cryer import Cryer
from dacore_biot.analytic.harmonic import Column
from dacore_biot.analytic.mandel import Mandel
from dacore_biot.analytic.medium import Medium
from dacore_biot.analytic.terzaghi import Terzaghi
from dacore_biot.analytic.uniform import SunkColumn, Uniform, drained, undrained
from dacore_biot.analytic.wave import Pulse, Wave

__all__ = [
    "Column",
    "Cryer",
    "Mandel",
    "Medium",
    "Pulse",
    "SunkColumn",
    "Terzaghi",
    "Uniform",
    "Wave",
    "drained",
    "undrained",
]
