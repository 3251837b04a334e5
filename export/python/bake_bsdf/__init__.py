"""Baked BSDFs in Python: three ONNX files that sample, evaluate and give the pdf of a material.

And the other way round: :func:`write_slices` writes any BSDF as a table that can be baked.
"""

from .slices import disk_grid, write_slices

__all__ = ["BakedMaterial", "disk_grid", "write_slices"]


def __getattr__(name):
    # Only this class needs onnxruntime, which a renderer that writes slices may not have.
    if name == "BakedMaterial":
        from .runtime import BakedMaterial

        return BakedMaterial
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
