"""A module that takes long to load, and makes an error of its own of an interrupt."""

import time

print("waiting", flush=True)
try:
    time.sleep(0.5)
except BaseException as error:
    raise ImportError("the library was not built for this machine") from error
