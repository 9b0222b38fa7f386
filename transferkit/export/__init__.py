"""Policies as files for other stacks."""

from transferkit.export.isaac_file import export_descriptor
from transferkit.export.leapp_file import export_leapp
from transferkit.export.onnx_file import PARITY_ROWS, export_onnx

__all__ = ["PARITY_ROWS", "export_descriptor", "export_leapp", "export_onnx"]
