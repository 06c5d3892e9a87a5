"""What drives a logged machine: held commands, joints as measured or told, and their doubts."""
