"""A recording of another tool, and the mapping that reads it."""

import json

from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from experiments.bench.faults.recordings import MAPPING as MAPPING


def write_foreign(path, steps=5, command=lambda k: k / 10):
    """States, commands a little later, a reward for all steps but the third; JSON and protobuf."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        plain = writer.register_schema("any", "jsonschema", b"{}")
        state, reward = (writer.register_channel(topic, "json", plain) for topic in ("/state", "/reward"))
        commands = writer.register_channel("/command", "protobuf", register_schema(writer, Vector3))
        for k in range(steps):
            at = 100 * k
            message = {"position": [k, 10 + k], "velocity": [20 + k, 30 + k]}
            writer.add_message(state, at, json.dumps(message).encode(), at)
            writer.add_message(commands, at + 10, Vector3(x=command(k)).SerializeToString(), at + 10)
            if k != 2:
                writer.add_message(reward, at + 20, json.dumps({"value": 7.0 + k, "done": k == 3}).encode(), at + 20)
        writer.finish()
    return path
