"""A policy from what a robot measures to the torques of its joints, as a network that other stacks run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from transferkit.export.onnx_file import ExportedPolicy
    from transferkit.export.ports import Ports
    from transferkit.spec import IOSpec


class Deployed(nn.Module):
    """Ports in their order: joint positions, joint velocities, others, measurements of before, actions of before."""

    linear: Tensor
    offset: Tensor
    angle: Tensor
    form: Tensor
    gear: Tensor

    def __init__(self, exported: ExportedPolicy, ports: Ports, spec: IOSpec) -> None:
        super().__init__()
        self.exported, self.ports = exported, ports
        for name in ("linear", "offset", "angle", "form"):
            self.register_buffer(name, torch.from_numpy(getattr(ports, name)))
        gears = [actuator.gear if actuator.joint is not None else 1.0 for actuator in spec.action]
        self.register_buffer("gear", torch.tensor(gears))
        sizes = {
            "joint_positions": len(ports.positions),
            "joint_velocities": len(ports.velocities),
            "others": len(ports.others),
            "measured_before": ports.measured * ports.past,
            "actions_before": spec.act_dim * ports.past_actions,
        }
        self.inputs = {name: size for name, size in sizes.items() if size}
        """Names and sizes of what there is of these."""

    @property
    def outputs(self) -> dict[str, int]:
        """Names and sizes of the results."""
        return {"torques": len(self.gear), **{f"{name}_next": n for name, n in self.inputs.items() if name.endswith("before")}}

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        """Compute torques `(1, act_dim)`, and what is fed back in the next step."""
        given = dict(zip(self.inputs, values, strict=True))
        now = [given[name] for name in ("joint_positions", "joint_velocities", "others") if name in given]
        before = [given[name] for name in ("measured_before", "actions_before") if name in given]
        everything = torch.cat([*now, *before], -1)
        angle = everything @ self.angle.T + self.offset
        linear = everything @ self.linear.T + self.offset
        control = self.exported(self.form[0] * linear + self.form[1] * angle.sin() + self.form[2] * angle.cos())
        results = [self.gear * control]
        if "measured_before" in given:
            results.append(torch.cat([*now, given["measured_before"]], -1)[:, : self.inputs["measured_before"]])
        if "actions_before" in given:
            results.append(torch.cat([control, given["actions_before"]], -1)[:, : self.inputs["actions_before"]])
        return tuple(results)
