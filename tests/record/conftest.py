import pytest

from transferkit.deploy import load_subject
from transferkit.record.play import record

ENV = "Hopper-v5"


@pytest.fixture(scope="session")
def subject():
    return load_subject("inverted-pendulum-v1", env=ENV)


@pytest.fixture(scope="session")
def recording(subject, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "hopper.mcap"
    record(subject, path, episodes=3, seed=4)
    return path
