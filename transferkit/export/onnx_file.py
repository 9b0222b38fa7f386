"""Export trained policies as ONNX files."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from transferkit.config.checks import check_kind
from transferkit.envs import derive_spec
from transferkit.errors import RunDirectoryError
from transferkit.export.drives import read_model
from transferkit.extras import import_extra
from transferkit.files import check_new, new_file
from transferkit.policy.health import play
from transferkit.record.format import Names
from transferkit.record.play import Subject
from transferkit.versions import versions

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.policy.base import Policy
    from transferkit.spec import IOSpec

PARITY_ROWS = 1000
"""Random observations on which an exported file is compared with torch."""


class ExportedPolicy(nn.Module):
    """A policy from raw observations `(B, obs_dim)` to controls `(B, act_dim)` in the actuators' own units."""

    centre: Tensor
    half_range: Tensor

    def __init__(self, policy: Policy, low: Tensor, high: Tensor, *, clip: bool) -> None:
        super().__init__()
        self.policy, self.clip = policy, clip
        self.register_buffer("centre", (low + high) / 2)
        self.register_buffer("half_range", (high - low) / 2)

    def forward(self, observation: Tensor) -> Tensor:
        """Compute the deterministic action, clipped as it is in the environment, and scaled."""
        action = self.policy(observation)[0]
        return self.centre + self.half_range * (action.clamp(-1.0, 1.0) if self.clip else action)


def export_onnx(subject: Subject, path: str | Path) -> float:
    """Write normaliser, adapters, core and scaling as one ONNX file, with the names of its inputs and outputs.

    Returns the largest difference to torch over 1,000 random observations.

    Raises:
        ConfigError: the file exists, its folder does not, it cannot be written, or ONNX cannot be imported.
        RunDirectoryError: the exported file does not act as the policy does.
    """
    path = Path(path)
    check_kind("subject", subject, Subject, "load it with load_subject")
    check_new(path, "out", ".onnx")
    onnx, runtime = (import_extra(name, "onnx", "export") for name in ("onnx", "onnxruntime"))
    spec = derive_spec(subject.env)
    exported = exported_policy(subject, spec)
    observation = _random_observations(subject.env)
    batch = ({0: torch.export.Dim("batch")},)
    model = onnx_program(exported, (observation[:2],), ["observation"], ["action"], batch).model_proto
    with torch.no_grad():
        expected = exported(observation)
    known = {"known_input": observation[:1].tolist(), "known_output": expected[:1].tolist()}
    onnx.helper.set_model_props(model, {name: json.dumps(value) for name, value in (_about(subject, spec) | known).items()})
    data = model.SerializeToString()
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    answer = torch.from_numpy(session.run(["action"], {"observation": observation.numpy()})[0])
    difference = float((answer - expected).abs().max())
    if not difference <= 1e-3 * float(exported.half_range.max()):
        raise RunDirectoryError(
            f"the exported policy differs from torch by {difference:.2g}, so nothing is written", remedy="report it"
        )
    with new_file(path, "out") as temporary:
        temporary.write_bytes(data)
    return difference


def exported_policy(subject: Subject, spec: IOSpec) -> ExportedPolicy:
    """Make the policy of a subject that answers with controls."""
    low, high = (torch.tensor([getattr(actuator, end) for actuator in spec.action]) for end in ("low", "high"))
    return ExportedPolicy(subject.policy, low, high, clip=subject.clip_actions).eval()


def onnx_program(
    module: nn.Module,
    examples: tuple[Tensor, ...],
    inputs: list[str],
    outputs: list[str],
    shapes: Any = None,  # noqa: ANN401
) -> torch.onnx.ONNXProgram:
    """Export a module; `shapes` are torch's dynamic shapes.

    Raises:
        ConfigError: ONNX cannot be imported.
    """
    for name in ("onnx", "onnxscript"):  # torch exports through the last
        import_extra(name, "onnx", "export")
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns that torchvision is not there
    program = torch.onnx.export(
        module,
        examples,
        dynamo=True,
        external_data=False,
        verbose=False,
        input_names=inputs,
        output_names=outputs,
        dynamic_shapes=shapes,
    )
    assert program is not None
    return program


def _about(subject: Subject, spec: IOSpec) -> dict[str, Any]:
    """What the numbers are, each value as JSON; the keys that mjlab has too are named as there, at full precision."""
    names, model = Names.of(spec), read_model(subject.env, spec)
    driven = [joint for actuator in spec.action for joint in spec.joints if joint.name == actuator.joint]
    gains = [] if model is None else [model.gains(spec, joint) for joint in driven]
    return {
        "env": spec.env_id,
        "observation_names": names.observation,
        "action_names": names.action,
        "action_low": [actuator.low for actuator in spec.action],
        "action_high": [actuator.high for actuator in spec.action],
        "observation_spec": [asdict(element) for element in spec.observation],
        "action_spec": [asdict(actuator) for actuator in spec.action],
        "joints": [asdict(joint) for joint in spec.joints],
        "joint_names": [joint.model_name for joint in driven],
        "default_joint_pos": [joint.reference for joint in driven],
        "joint_stiffness": [stiffness for stiffness, _ in gains],
        "joint_damping": [damping for _, damping in gains],
        "action_scale": [actuator.gear for actuator in spec.action],
        "command_kinds": [] if model is None else [drive.command for drive in model.drives],
        "command_names": [],
        "time_step": spec.time_step,
        "hold": subject.policy.hold,
        "control_period": spec.time_step * subject.policy.hold,
        "versions": versions(),
        "source": subject.about,
    }


def _random_observations(env: EnvLike) -> Tensor:
    """Observations of random play, and their multiples."""
    seen = torch.from_numpy(play(env, PARITY_ROWS, 0))
    return seen * torch.linspace(0.1, 3.0, len(seen)).unsqueeze(-1)
