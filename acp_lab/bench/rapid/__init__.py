"""RAPID, OLS and GOS of OpenCV's contrib modules, in an environment of their own.

opencv-contrib-python-headless owns the same folder cv2/ as the package that everything else here uses, so the two
cannot live together. `environment` makes the other environment, `worker` runs in it, `tracker` speaks to it over a
pipe.
"""
