"""Baked BSDFs in Python: three ONNX files that sample, evaluate and give the pdf of a material."""

from .runtime import BakedMaterial

__all__ = ["BakedMaterial"]
