"""Playing a policy to be watched: in MuJoCo's viewer, as a video, or as a strip of pictures."""
