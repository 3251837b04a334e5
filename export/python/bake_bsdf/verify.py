"""Checks the ONNX files of a baked material: ``python -m bake_bsdf.verify FOLDER VECTORS.json``.

Every file must pass the full ONNX checker and strict shape inference, answer an empty batch, and give the
answers in VECTORS.json within the tolerances that stand beside them. That file maps each role to its inputs
and expected outputs, lists of rows, and ``tolerance`` maps each output to its own:

    {"tolerance": {"wi": 1e-5, ...}, "sample": {"wo": [[x, y, z], ...], "u": [...], "wi": [...], ...}, ...}

Where the material leaves parameters free, each role has ``params`` as well, and parameters that are given once must
answer as if every query had them. A difference is max |a − b| / max(1, |b|). Exit status: 0 when all is well, 1 on a mismatch, 2 on bad input.
"""

import json
import sys
from pathlib import Path

import numpy as np
import onnx

from .runtime import BakedMaterial

INPUTS = {"sample": ("wo", "u"), "eval": ("wo", "wi"), "pdf": ("wo", "wi")}
OUTPUTS = {"sample": ("wi", "weight", "jacobian"), "eval": ("f_cos",), "pdf": ("pdf",)}


def check_file(path):
    """Raises unless ``path`` is a valid model by the strictest checks that onnx has."""
    model = onnx.load(str(path))
    onnx.checker.check_model(model, full_check=True)
    onnx.shape_inference.infer_shapes(model, check_type=True, strict_mode=True, data_prop=True)


def run(material, role, rows, params=None):
    """The outputs of one network for the inputs in ``rows``, always as a tuple."""
    answer = getattr(material, role)(*(rows[name] for name in INPUTS[role]), params=params)
    return tuple(answer) if role == "sample" else (answer,)


def max_difference(found, expected):
    """max |a − b| / max(1, |b|); infinite where shapes differ or an answer is not finite."""
    expected = np.asarray(expected, dtype=np.float64)
    if found.shape != expected.shape or not np.isfinite(found).all():
        return np.inf
    return float(np.max(np.abs(found - expected) / np.maximum(1.0, np.abs(expected)), initial=0.0))


def verify(folder, vectors):
    """Prints every difference; returns whether all are within their tolerances."""
    material = BakedMaterial(folder)
    good = True
    for role in INPUTS:
        check_file(Path(folder) / f"{role}.onnx")
        rows = {name: np.asarray(values) for name, values in vectors[role].items()}
        params = rows.get("params")
        none_of = {name: values[:0] for name, values in rows.items()}
        empty = run(material, role, none_of, none_of.get("params"))
        answers = run(material, role, rows, params)
        if params is not None:
            once = run(material, role, rows, params[0])
            repeated = run(material, role, rows, np.repeat(params[:1], len(params), axis=0))
            same = all(np.array_equal(a, b) for a, b in zip(once, repeated, strict=True))
            good &= same
            print(f"{role}: parameters given once, {'ok' if same else 'MISMATCH'}")
        for name, none, found in zip(OUTPUTS[role], empty, answers, strict=True):
            difference = max_difference(found, rows[name])
            within = difference <= vectors["tolerance"][name] and none.shape == (0, found.shape[1])
            good &= within
            print(f"{role}.{name}: {len(found)} rows, max difference {difference:.2e}, {'ok' if within else 'MISMATCH'}")
    return good


def main(arguments):
    """The command line."""
    if len(arguments) != 2:
        print("usage: python -m bake_bsdf.verify FOLDER VECTORS.json", file=sys.stderr)
        return 2
    folder, path = arguments
    try:
        vectors = json.loads(Path(path).read_text(encoding="utf-8"))
        return 0 if verify(folder, vectors) else 1
    except (OSError, KeyError, ValueError) as error:
        print(f"verify: {error!r}", file=sys.stderr)
        return 2
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError) as error:
        print(f"verify: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
