"""Baked BSDFs in Python: three ONNX files that sample, evaluate and give the pdf of a material.

And the other way round: :func:`write_slices` writes any BSDF as a table that can be baked. :func:`read_maps` reads a
database of importance maps.
"""

from .slices import disk_grid, write_slices

__all__ = ["BakedMaterial", "disk_grid", "read_maps", "write_slices"]


def __getattr__(name):
    # Only these need onnxruntime and safetensors, which a renderer that writes slices may not have.
    if name == "BakedMaterial":
        from .runtime import BakedMaterial

        return BakedMaterial
    if name == "read_maps":
        from .maps import read_maps

        return read_maps
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
