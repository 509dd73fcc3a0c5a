"""caproto's client moves what an IOC serves, and says how it went, as JSON: PREFIX."""

import json
import sys
import time

from caproto import ErrorResponseReceived
from caproto.sync.client import read, write

prefix = sys.argv[2]


def get(name):
    return read(prefix + name, timeout=20, repeater=False).data[0].item()


said = {"begin": get(".RBV"), "done": get(".DMOV")}
write(prefix + ".VAL", [30], notify=True, timeout=20, repeater=False)
said["moving"] = get(".DMOV")
for _ in range(400):
    if get(".DMOV"):
        break
    time.sleep(0.02)
time.sleep(0.2)
said["end"], said["target"] = get(".RBV"), get(".VAL")
write(prefix + ".STOP", [1], notify=True, timeout=20, repeater=False)
try:
    write(prefix + ".VAL", [10**7], notify=True, timeout=20, repeater=False)
except ErrorResponseReceived as error:
    said["error"] = str(error)
said["after"] = get(".VAL")
print(json.dumps(said))
