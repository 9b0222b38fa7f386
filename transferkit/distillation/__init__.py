"""A student on other observations from a teacher that has its own."""

from transferkit.distillation.config import DistillConfig
from transferkit.distillation.distill import Distilled, distill

__all__ = ["DistillConfig", "Distilled", "distill"]
