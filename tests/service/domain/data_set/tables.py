"""A small right data set as text, to be spoilt cell by cell."""

from __future__ import annotations

CONDITIONS = """condition,test,material,mass_kg,moisture_percent,psd,holdout
p1,pile,coke,100,,0.02:0.3;0.05:0.7,
p2,pile,coke,200,4,,0
c1,charge,sinter,3000,,,1
"""
_VALUES = {"p1": (36.2, 35.8, 36.9), "p2": (34.1, 34.8, 34.4)}
_ROWS = [
    f"{name},{k},repose_angle_deg,{value},deg,0.1"
    for name, values in _VALUES.items()
    for k, value in enumerate(values)
]
_ROWS += [f"c1,{k},belt_depth_m,{depth},m," for k, depth in enumerate((0.121, 0.126, 0.118))]
OBSERVATIONS = "\n".join(["condition,replicate,observable,value,unit,sensor_sd", *_ROWS]) + "\n"


def tables(**changed: str) -> dict[str, str]:
    """Texts by file name; `conditions=` or `observations=` replaces one, `profiles=` adds one."""
    texts = {"conditions": CONDITIONS, "observations": OBSERVATIONS} | changed
    return {f"{name}.csv": text for name, text in texts.items()}
