"""Files that are damaged, planted or wrong: refused in one line, and nothing of them runs."""

import base64
import contextlib
import importlib.util
import io
import json
import os
import pickle
import struct
import zipfile

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.interop import writers
from transferkit import import_core, load_core
from transferkit.envs import derive_spec
from transferkit.errors import ArtifactError, ConfigError, DimensionError, TransferkitError
from transferkit.interop import Given, read_core
from transferkit.interop.unpickle import unpickle
from transferkit.reading import FormatError

ENV = "InvertedPendulum-v5"


class Planted:
    """Touches a file when it is unpickled by pickle."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


@pytest.fixture
def planted(tmp_path):
    return Planted(tmp_path / "it-ran")


@pytest.fixture(scope="session")
def sb3_zip(tmp_path_factory):
    path = tmp_path_factory.mktemp("sb3") / "m.zip"
    writers.sb3_model("SAC", ENV).save(path)
    return path


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory):
    path = tmp_path_factory.mktemp("rsl") / "model_1.pt"
    torch.save({"actor_state_dict": writers.rsl_rl_actor(4, 1)[0].state_dict(), "iter": 1, "infos": None}, path)
    return path


def rewritten(source, path, change):
    """Copy a zip with some members replaced, added or, as None, left out."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(path, "w") as new:
        members = {name: old.read(name) for name in old.namelist()}
        for name, data in {**members, **change(members)}.items():
            if data is not None:
                new.writestr(name, data)
    return path


def saved(value):
    buffer = io.BytesIO()
    torch.save(value, buffer)
    return buffer.getvalue()


def refused(path, *words, env=ENV, error=ArtifactError, **options):
    with pytest.raises(error) as caught:
        import_core(path, env=env, **{"stats": "none", **options})
    text = str(caught.value)
    assert "\n" not in text
    assert all(word in text for word in words), text


def test_a_planted_pickle_never_runs(tmp_path, planted, sb3_zip, checkpoint):
    def in_torch(members):
        root = next(name for name in members if name.endswith("data.pkl"))
        return {root: pickle.dumps(planted)}

    places = {
        "rsl_rl.pt": rewritten(checkpoint, tmp_path / "rsl_rl.pt", in_torch),
        "infos.pt": tmp_path / "infos.pt",
        "weights.zip": rewritten(sb3_zip, tmp_path / "weights.zip", lambda _: {"policy.pth": saved({"x": planted})}),
        "older.zip": rewritten(sb3_zip, tmp_path / "older.zip", lambda _: {"policy.pth": pickle.dumps(planted)}),
        "sbx.zip": writers.sbx_zip(tmp_path / "sbx.zip", {"actor": {}}, planted=planted),
        "bare.pt": tmp_path / "bare.pt",
        "cleanrl.cleanrl_model": tmp_path / "cleanrl.cleanrl_model",
    }
    places["infos.pt"].write_bytes(saved({"actor_state_dict": {}, "iter": 1, "infos": planted}))
    places["bare.pt"].write_bytes(pickle.dumps(planted))
    places["cleanrl.cleanrl_model"].write_bytes(saved((writers.CleanRLPPO(4, 1).state_dict(), planted)))
    for path in places.values():
        refused(path, path.name)
    stats = tmp_path / "stats.pkl"
    stats.write_bytes(pickle.dumps(planted))
    refused(sb3_zip, "stats.pkl", "posix.system", stats=stats)
    np.savez(tmp_path / "stats.npz", mean=np.array([planted], dtype=object), var=np.ones(1))
    refused(sb3_zip, "stats.npz", stats=tmp_path / "stats.npz")
    assert not planted.path.exists()


def test_pickles_in_the_data_of_stable_baselines3_are_never_opened(tmp_path, planted, sb3_zip):
    blob = {":type:": "<class 'dict'>", ":serialized:": base64.b64encode(pickle.dumps(planted)).decode()}

    def everywhere(members):
        data = {name: blob if isinstance(value, dict) else value for name, value in json.loads(members["data"]).items()}
        extra = {"pytorch_variables.pth": pickle.dumps(planted), "policy.optimizer.pth": pickle.dumps(planted)}
        return {"data": json.dumps({**data, "planted": blob}).encode(), **extra}

    core = import_core(rewritten(sb3_zip, tmp_path / "m.zip", everywhere), env=ENV, stats="none")
    assert core.architecture.hidden == (16, 16)
    assert not planted.path.exists()


def test_an_activation_of_jax_that_torch_has_otherwise_is_asked_for(tmp_path):
    for said in ("<function gelu at 0x7f>", "<jax._src.custom_derivatives.custom_jvp object at 0x7f>"):
        kwargs = {"activation_fn": said}
        path = writers.sbx_zip(tmp_path / "m.zip", {"actor": writers.dense(4, 3, 1)}, policy_kwargs=kwargs)
        refused(path, "does not say the activation", error=ConfigError)


def test_what_a_zip_of_sbx_refers_to_is_never_run(tmp_path, planted):
    path = writers.sbx_zip(tmp_path / "m.zip", {"actor": writers.dense(4, 3, 1)}, planted=planted)
    core = import_core(path, env=ENV, stats="none")
    assert core.architecture.hidden == (3,)
    assert not planted.path.exists()


def test_a_pickle_refers_to_nothing_by_tricks(planted):
    command = f"touch {planted.path}"
    for blob in (
        b"\x80\x04\x8c\x05posix\x8c\x06system\x93X" + struct.pack("<I", len(command)) + command.encode() + b"\x85R.",
        f"cnumpy\ntesting._private.utils.os.system\n(S'{command}'\ntR.".encode(),  # by a path through another package
        b"\x82\x01.",  # by the registry of extensions
        b"\x80\x02Nr\xff\xff\xff\x7f.",  # 16 GB of memo
        b"\x80\x05\x96\xff\xff\xff\xff\xff\x00\x00\x00.",  # 1 TB of bytes
    ):
        with contextlib.suppress(FormatError):
            assert not callable(unpickle(blob, {}, ("numpy",)))
    assert not planted.path.exists()


def test_zips_and_tensors_are_no_larger_than_their_file(tmp_path, sb3_zip, checkpoint):
    bomb = tmp_path / "bomb.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", b" " * 50_000_000)
        archive.writestr("_stable_baselines3_version", "2")
    refused(bomb, "unpacks to 50,000,001 bytes")

    def huge(members):
        name = next(name for name in members if name.endswith("data.pkl"))
        old, new = b"K K\x04\x86", b"J" + struct.pack("<i", 2**30) + b"K\x04\x86"  # the shape (32, 4) of the first layer
        assert old in members[name]
        return {name: members[name].replace(old, new, 1)}

    path = rewritten(checkpoint, tmp_path / "huge.pt", huge)
    refused(path, "larger than its storage", activation="elu", action_scale=1.0, stats=None)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e39])
def test_numbers_must_be_finite(tmp_path, bad):
    state = writers.CleanRLPPO(4, 1).state_dict()
    state["actor_mean.2.weight"] = state["actor_mean.2.weight"].double()
    state["actor_mean.2.weight"][0, 0] = bad
    torch.save(state, tmp_path / "m.pt")
    refused(tmp_path / "m.pt", "finite")


@pytest.fixture(scope="session")
def samples(tmp_path_factory, sb3_zip, checkpoint):
    """A file of each format, with what it does not say; of statistics, the file that they are beside."""
    folder = tmp_path_factory.mktemp("samples")
    venv = writers.normalized(ENV)
    venv.save(folder / "stats.pkl")
    np.savez(folder / "stats.npz", mean=np.zeros(4), var=np.ones(4))
    torch.save(writers.CleanRLPPO(4, 1).state_dict(), folder / "m.cleanrl_model")
    dense = [{"kernel": np.ones((n, m), np.float32), "bias": np.ones(m, np.float32)} for n, m in ((4, 3), (3, 1))]
    arrays = {"actor": {"params": {f"Dense_{k}": layer for k, layer in enumerate(dense)}}}
    (folder / "m.msgpack").write_bytes(msgspec.msgpack.encode(arrays, enc_hook=flax_array))
    every = {sb3_zip: {"stats": "none"}, checkpoint: {"activation": "elu", "action_scale": 1.0}}
    every |= {writers.sbx_zip(folder / "x.zip", {"actor": writers.dense(4, 3, 1)}): {"stats": "none"}}
    every |= {folder / "m.cleanrl_model": {"stats": "none"}, folder / "m.msgpack": {"activation": "relu", "stats": "none"}}
    if importlib.util.find_spec("onnx"):
        writers.write_onnx(writers.Front(4, 1, torch.nn.ReLU()), 4, folder / "m.onnx")
        every[folder / "m.onnx"] = {"action_scale": 1.0}
    return [*every.items(), *((folder / name, {"beside": sb3_zip}) for name in ("stats.pkl", "stats.npz"))]


def flax_array(array):
    packed = msgspec.msgpack.encode((array.shape, array.dtype.name, array.tobytes()))
    return msgspec.msgpack.Ext(1, packed)


def read(path, beside=None, **options):
    spec = derive_spec(ENV)
    return read_core(beside or path, spec, Given(**options, **({"stats": path} if beside else {})), "x")[0]


def test_the_samples_are_read(samples):
    for path, options in samples:
        assert read(path, **options).architecture.obs_dim == 4


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_file_is_refused_or_read(tmp_path, samples, data):
    source, options = data.draw(st.sampled_from(samples))
    content = bytearray(source.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / f"damaged{source.suffix}"
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content)
    error = None
    try:
        read(path, **options).policy()
    except TransferkitError as refusal:
        error = refusal
    assert "\n" not in str(error)


def test_what_a_file_does_not_say_is_asked_for(sb3_zip, checkpoint):
    refused(sb3_zip, "normalised", "stats=none", stats=None, error=ConfigError)
    refused(checkpoint, "activation", stats=None, error=ConfigError)
    refused(checkpoint, "action_scale=bounds", stats=None, activation="elu", error=ConfigError)
    refused(checkpoint, "statistics of its own", activation="elu", action_scale=1.0, error=ConfigError)
    with pytest.raises(ConfigError, match=r"does not say its environment; give env"):
        load_core(checkpoint)
    with pytest.raises(ConfigError, match=r"make a core of it first, `transferkit import .* --env SOURCE"):
        load_core(checkpoint, env=ENV)


def test_another_environment_is_refused_in_one_line(tmp_path, sb3_zip):
    refused(
        sb3_zip,
        "m-v1 takes 4 observations and gives 1 actions",
        "has 11 and 3",
        env="Hopper-v5",
        error=DimensionError,
        name="m",
        zoo=tmp_path,
    )
