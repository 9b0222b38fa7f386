"""What a type checker needs to know of imageio_ffmpeg, which has no types."""

from _typeshed import Incomplete

def write_frames(
    path: str,
    size: tuple[int, int],
    *,
    fps: float,
    macro_block_size: int,
    ffmpeg_log_level: str,
    output_params: list[str],
) -> Incomplete: ...
def count_frames_and_secs(path: str) -> tuple[int, float]: ...
