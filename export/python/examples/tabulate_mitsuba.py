"""Tabulates a BSDF of Mitsuba 3, so that ``bake`` can import and bake it.

    python tabulate_mitsuba.py --bsdf roughconductor --material Cu --alpha 0.2 --out copper.safetensors
    python tabulate_mitsuba.py --bsdf roughplastic --sweep alpha=0.05,0.1,0.2,0.4 --out plastic.safetensors
    python tabulate_mitsuba.py --bsdf '{"type": "principled", "roughness": 0.3, "anisotropic": 0.8}' --out p.safetensors

``--bsdf`` is the type of a plugin, whose properties follow as options of their own names, or its whole dictionary
as JSON. Numbers, lists of three numbers (RGB) and dictionaries are JSON; everything else is text. Every ``--sweep
NAME=VALUE,VALUE,…`` makes a property (``a.b`` for b in the nested dictionary a) a parameter of the table.

Only reflection is tabulated, and perfectly specular parts cannot be. The lobes decide how fine the grid must be: a
pixel is 2/SIZE wide on the disk, and lobes of neighbouring θ should overlap.

Needs ``pip install mitsuba numpy`` and this package (``PYTHONPATH=export/python`` or ``pip install export/python``);
made with Mitsuba 3.9.1.
"""

import argparse
import itertools
import json
import sys
import time

import numpy as np
from bake_bsdf.slices import disk_grid, write_slices

VARIANT = "scalar_rgb"
"""Evaluates one direction at a time, which needs no compiler at run time."""

THETA = [*range(0, 80, 2), *range(80, 88), 88, 88.5, 89, 89.5]
"""θ_o of the table, degrees, unless told otherwise."""

PHI_COUNT = 36
"""Azimuths for an anisotropic BSDF, unless told otherwise."""

POINTS_HELP = """points per side of a pixel; more than 1 blurs, but misses no lobe narrower than a pixel (default
%(default)s)"""


def value(text):
    """A property from the command line: JSON where it is, text where not; three numbers are a colour."""
    try:
        parsed = json.loads(text)
    except ValueError:
        return text
    if isinstance(parsed, list) and len(parsed) == 3:
        return {"type": "rgb", "value": parsed}
    return parsed


def arguments(argv):
    """The options, and the dictionary of the BSDF."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--bsdf", required=True, help="type of a plugin, or a dictionary as JSON")
    parser.add_argument("--out", required=True, help="the file to write")
    parser.add_argument("--sweep", action="append", default=[], metavar="NAME=V,V,…", help="a free parameter")
    parser.add_argument("--size", type=int, default=64, help="pixels per side of a slice (default %(default)s)")
    parser.add_argument("--points", type=int, default=1, help=POINTS_HELP)
    parser.add_argument("--theta", help="comma-separated degrees (default: 52, dense at the horizon)")
    parser.add_argument("--phi-count", type=int, help=f"azimuths (default: {PHI_COUNT} if anisotropic, else 1)")
    options, properties = parser.parse_known_args(argv)
    bsdf = value(options.bsdf)
    if not isinstance(bsdf, dict):
        bsdf = {"type": options.bsdf}
    names, values = properties[::2], properties[1::2]
    if len(properties) % 2 or not all(name.startswith("--") for name in names):
        parser.error(f"properties must be pairs --NAME VALUE, not {' '.join(properties)}")
    bsdf.update((name.removeprefix("--").replace("-", "_"), value(text)) for name, text in zip(names, values))
    try:
        options.theta = [float(t) for t in options.theta.split(",")] if options.theta else THETA
        options.sweep = [parse_sweep(text) for text in options.sweep]
    except ValueError as error:
        parser.error(str(error))
    return options, bsdf


def parse_sweep(text):
    """NAME and numbers of NAME=V,V,…"""
    name, _, values = text.partition("=")
    if not name or not values:
        raise ValueError(f"a sweep is NAME=VALUE,VALUE,… and not {text}")
    return name, [float(v) for v in values.split(",")]


def with_property(bsdf, name, number):
    """A copy of the dictionary ``bsdf`` whose property ``name``, perhaps of a nested dictionary, is ``number``."""
    outer, _, inner = name.partition(".")
    if not inner:
        return {**bsdf, outer: number}
    if not isinstance(bsdf.get(outer), dict):
        raise ValueError(f"the BSDF has no dictionary `{outer}` for the sweep over `{name}`")
    return {**bsdf, outer: with_property(bsdf[outer], inner, number)}


def load(bsdf):
    """The BSDF of a dictionary, refused where a table cannot hold it."""
    import mitsuba as mi

    loaded = mi.load_dict(bsdf)
    flags = loaded.flags()
    if any(mi.has_flag(flags, flag) for flag in (mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission)):
        raise ValueError(f"`{bsdf['type']}` has a perfectly specular part, which no table can hold")
    return loaded, mi.has_flag(flags, mi.BSDFFlags.Anisotropic)


def evaluator(bsdf):
    """A function (wo, wi ``[n, 3]``) → f·cos θ_i ``[n, 3]``.

    Mitsuba's ``si.wi`` is our ``wo``, and its ``wo`` our ``wi``.
    """
    import mitsuba as mi

    context = mi.BSDFContext()
    si = mi.SurfaceInteraction3f()
    si.n = si.sh_frame.n = mi.Normal3f(0, 0, 1)
    si.sh_frame.s = si.dp_du = mi.Vector3f(1, 0, 0)
    si.sh_frame.t = si.dp_dv = mi.Vector3f(0, 1, 0)
    si.uv = mi.Point2f(0.5, 0.5)

    def evaluate(wo, wi):
        si.wi = mi.Vector3f(*wo)
        return np.array([bsdf.eval(context, si, mi.Vector3f(*w)) for w in wi.tolist()]).reshape(-1, 3)

    return evaluate


def slice_of(evaluate, wo, size, points):
    """``[size, size, 3]``: the mean of f over the points of each pixel inside the disk, times its centre's cosine."""
    fine, inside = disk_grid(size * points, size * points)
    f = np.zeros((*inside.shape, 3))
    f[inside] = evaluate(wo, fine[inside]) / fine[inside][:, 2:]
    pixels = (size, points, size, points)
    counts = inside.reshape(pixels).sum(axis=(1, 3))
    mean = f.reshape(*pixels, 3).sum(axis=(1, 3)) / np.maximum(counts, 1)[..., None]
    wi, mask = disk_grid(size, size)
    return np.where(mask[..., None], mean * wi[..., 2:], 0)


def direction(theta, phi):
    """The unit vector of polar angle ``theta`` and azimuth ``phi``, degrees."""
    theta, phi = np.radians([theta, phi])
    return [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]


def tabulate(bsdf, options):
    """Rows of the table: parameters, wo in degrees, slices."""
    names = [name for name, _ in options.sweep]
    loaded = []
    for params in itertools.product(*(values for _, values in options.sweep)):
        bound = bsdf
        for name, number in zip(names, params):
            bound = with_property(bound, name, number)
        loaded.append((params, *load(bound)))
    phi_count = options.phi_count or (PHI_COUNT if any(anisotropic for *_, anisotropic in loaded) else 1)
    views = list(itertools.product(options.theta, (360 * k / phi_count for k in range(phi_count))))
    rows = []
    for params, plugin, _ in loaded:
        evaluate = evaluator(plugin)
        for theta, phi in views:
            rows.append((params, (theta, phi), slice_of(evaluate, direction(theta, phi), options.size, options.points)))
    params, wo, f_cos = zip(*rows)
    return np.array(params).reshape(len(rows), -1), np.array(wo), np.array(f_cos)


def main(argv):
    """The command line."""
    options, bsdf = arguments(argv)
    try:
        import mitsuba as mi
    except ImportError:
        print("tabulate_mitsuba: Mitsuba 3 is missing: pip install mitsuba", file=sys.stderr)
        return 2
    mi.set_variant(VARIANT)
    start = time.monotonic()
    try:
        params, wo, f_cos = tabulate(bsdf, options)
        names = [name for name, _ in options.sweep]
        write_slices(options.out, params, wo, f_cos, names, f"Mitsuba {mi.__version__}: {json.dumps(bsdf)}")
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        print(f"tabulate_mitsuba: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    seconds = time.monotonic() - start
    print(f"{options.out}: {len(wo)} slices of {options.size} × {options.size} pixels in {seconds:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
