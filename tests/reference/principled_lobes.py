"""Writes principled_lobes.json: values of Mitsuba's `principled` plugin for every lobe and parameter.

Run it with an interpreter that has Mitsuba 3.9.1 (`pip install mitsuba==3.9.1`):

    python principled_lobes.py

Mitsuba's directions are the other way round: its `si.wi` is our wo, its `wo` our wi. Every plugin is made anew from a
dictionary, as a scene file would be, because parameters changed afterwards are not treated alike (`specular` 0
then becomes 0.001).

Mitsuba computes in f32, and the density of the clearcoat's normals as 1 - (1 - alpha^2) cos^2: with full gloss, up to
a sixth of the value next to the peak is round-off. A few roundings of 6e-8 change a denominator of DENOMINATOR_MIN
by a quarter of a percent, so directions with less than that are drawn again; the file says how many were.
"""

import json
import math
import random
from pathlib import Path

import mitsuba as mi

SEED = 20240601
DENOMINATOR_MIN = 1e-4
RANDOM_ROWS = 240
"""Rows in which every parameter is drawn."""
ROWS_PER_EDGE = 4
"""Rows for each parameter at 0 and at 1 with all others at their defaults, or at those of COMPANIONS."""

SCALARS = [
    "metallic",
    "roughness",
    "specular",
    "specular_tint",
    "anisotropic",
    "sheen",
    "sheen_tint",
    "clearcoat",
    "clearcoat_gloss",
    "flatness",
]
MITSUBA_NAMES = {"specular_tint": "spec_tint"}
COMPANIONS = {"sheen_tint": {"sheen": 0.7}, "clearcoat_gloss": {"clearcoat": 0.8}}
"""Parameters that another one must switch on."""
BASE_COLOR = [0.8, 0.4, 0.1]


def direction(angles):
    theta, phi = map(math.radians, angles)
    return [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]


def plugin(params):
    scalars = {MITSUBA_NAMES.get(k, k): v for k, v in params.items() if k != "base_color"}
    color = {"type": "rgb", "value": params["base_color"]}
    return mi.load_dict({"type": "principled", "base_color": color, **scalars})


def evaluate(bsdf, wo, wi):
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(wo)
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wi))
    return [float(c) for c in value]


def coat_denominator(params, wo, wi):
    """sin^2 + alpha^2 cos^2 of the half vector: what the density of the clearcoat's normals divides by."""
    alpha = 0.1 + (0.001 - 0.1) * params.get("clearcoat_gloss", 0.0)
    half = [a + b for a, b in zip(wo, wi)]
    cos2 = half[2] ** 2 / sum(c * c for c in half)
    return 1 - cos2 + alpha * alpha * cos2


def draw_directions(rng):
    """Anywhere, next to the mirror direction, in the plane of wo forwards and backwards, and grazing."""
    theta, phi = rng.uniform(0, 89), rng.uniform(0, 360)
    kind = rng.randrange(5)
    if kind == 0:
        wi = (rng.uniform(0, 89), rng.uniform(0, 360))
    elif kind == 1:
        wi = (abs(theta + rng.gauss(0, 4)), phi + 180 + rng.gauss(0, 6))
    elif kind == 2:
        wi = (abs(theta + rng.gauss(0, 0.3)), phi + 180 + rng.gauss(0, 0.5))
    elif kind == 3:
        wi = (rng.uniform(0, 89), phi + rng.choice([0, 180]) + rng.gauss(0, 20))
    else:
        theta = rng.uniform(80, 89)
        wi = (rng.uniform(70, 89), phi + rng.choice([0, 180]) + rng.gauss(0, 30))
    return [
        [round(theta, 3), round(phi, 3)],
        [round(min(wi[0], 89.0), 3), round(wi[1] % 360, 3)],
    ]


def draw_params(rng):
    """One value in eight at 0, one in eight at 1."""

    def value():
        return rng.choice([0.0, 1.0] + 6 * [round(rng.random(), 3)])

    return {"base_color": [value() for _ in range(3)], **{name: value() for name in SCALARS}}


def edges():
    """Every parameter alone at 0 and at 1."""
    for edge in (0.0, 1.0):
        yield {"base_color": [edge] * 3}
        for name in SCALARS:
            yield {"base_color": BASE_COLOR, **COMPANIONS.get(name, {}), name: edge}


def main():
    mi.set_variant("scalar_rgb")
    rng = random.Random(SEED)
    rows, drawn = [], 0
    wanted = [params for params in edges() for _ in range(ROWS_PER_EDGE)]
    wanted += [draw_params(rng) for _ in range(RANDOM_ROWS)]
    for params in wanted:
        bsdf = plugin(params)
        while True:
            drawn += 1
            wo_deg, wi_deg = draw_directions(rng)
            wo, wi = direction(wo_deg), direction(wi_deg)
            has_coat = params.get("clearcoat", 0.0) > 0
            if not has_coat or coat_denominator(params, wo, wi) >= DENOMINATOR_MIN:
                break
        value = evaluate(bsdf, wo, wi)
        row = {**params, "wo_deg": wo_deg, "wi_deg": wi_deg}
        rows.append({**row, "eval_fcos": [float(f"{c:.7g}") for c in value]})
    note = (
        f"Mitsuba {mi.__version__} 'principled', scalar_rgb, float32, written by principled_lobes.py: wo camera side "
        "(Mitsuba si.wi), wi light side; angles in degrees (theta, phi); eval_fcos includes cos(theta_i), RGB, per sr; "
        "parameters that a row does not name have Mitsuba's defaults. "
        f"{len(rows)} rows of {drawn} drawn; in the others the clearcoat's peak is dominated by round-off."
    )
    text = ",\n".join(json.dumps(row) for row in rows)
    path = Path(__file__).with_suffix(".json")
    path.write_text(f'{{\n"note": {json.dumps(note)},\n"rows": [\n{text}\n]\n}}\n')


if __name__ == "__main__":
    main()
