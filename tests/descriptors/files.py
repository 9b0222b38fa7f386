"""Descriptors of Hopper-v5 as other stacks would write them, right or with a slip."""

import yaml

from transferkit.envs import derive_spec

DEGREES = 57.29577951308232


def isaac(path, *, joints=("foot_joint", "thigh_joint", "leg_joint"), degrees=False, pose=(0.1, -0.4, 0.2), scale=100.0):
    """IO descriptors of a hopper whose joints stand in another order, with a default pose."""
    term = lambda name, size, **more: {"name": name, "shape": [size], "overloads": {"scale": None, "history_length": 0}, **more}  # noqa: E731
    names = {"joint_names": list(joints)}
    root = {"joint_names": ["rootz", "rooty"]}
    speeds = {"joint_names": ["rootx", "rootz", "rooty"]}
    observations = [
        term("joint_pos", 2, **root),
        term("joint_pos_rel", 3, joint_pos_offsets=list(pose), **names),
        term("joint_vel", 3, **speeds),
        term("joint_vel_rel", 3, **names),
    ]
    observations[1]["overloads"]["scale"] = DEGREES if degrees else None
    actions = [{"name": "joint_effort_action", "shape": [3], "scale": scale, "offset": 0.0, "clip": None, **names}]
    path.write_text(yaml.safe_dump({"actions": actions, "observations": {"policy": observations}, "scene": {"dt": 0.008}}))
    return path


def leapp(path, *, position=("rootz", "rooty", "thigh_joint", "leg_joint", "foot_joint"), frequency=125):
    """LEAPP YAML of a hopper in the order of the environment."""
    spec = derive_spec("Hopper-v5")
    port = lambda name, kind, names: {  # noqa: E731
        "name": name,
        "dtype": "float32",
        "shape": [1, len(names)],
        "type": "tensor",
        "kind": kind,
        "element_names": [None, list(names)],
    }
    inputs = [
        port("joint_pos", "state/joint/position", position),
        port("joint_vel", "state/joint/velocity", [joint.model_name for joint in spec.joints]),
    ]
    outputs = [port("torques", "target/joint/torques", ["thigh_joint", "leg_joint", "foot_joint"])]
    parameters = {"model_path": "policy.onnx", "md5sum": "0", "sha256sum": "0", "backend": "onnx"}
    models = {"policy": {"inputs": inputs, "outputs": outputs, "parameters": parameters}}
    pipeline = {"data_flow": {}, "feedback_flow": {}, "inputs": {}, "outputs": {}, "configs": {"frequency": frequency}}
    path.write_text(yaml.safe_dump({"models": models, "pipeline": pipeline, "system information": {}}, sort_keys=False))
    return path
