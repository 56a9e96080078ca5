"""Room for images in shared memory, and quick discovery.

Pure: it sets an environment variable that the middleware reads when it starts.

Fast DDS gives a process 512 KiB of shared memory for what it publishes. A stereo pair of 512 x 512 pixels fills it, and
a best-effort subscriber (REP-2003: what sensor data is heard with) loses every sample that comes while it is full: a
fifth to all of the pairs between processes. The profile beside this module makes it 8 MiB.

A process that starts is heard by the others at once, but their answer often reaches it before it listens; it then
learns of them when they next announce themselves, by default every three seconds (one start in three took two to three
seconds for that). The profile makes it half a second, so that a node that was started again is back at once.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from importlib import resources
from pathlib import Path

# Any of these means that the user has arranged the transport, and knows better.
USER_SETTINGS = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTDDS_BUILTIN_TRANSPORTS',
    'SKIP_DEFAULT_XML',
)
# So do these files in the working folder, which Fast DDS reads by itself.
USER_FILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')


def make_room_for_images(environment: MutableMapping[str, str] = os.environ, folder: Path | None = None) -> bool:
    """Name our profile to Fast DDS, unless the user names another.

    Call it before the first node is made. Other middlewares do not read the variable.

    Parameters
    ----------
    environment : mutable mapping of str to str
        Environment variables; those of this process where it is left out.
    folder : pathlib.Path, optional
        Where a user's profile would lie; the working folder where it is left out.

    Returns
    -------
    bool
        Whether our profile was named.

    Examples
    --------
    >>> make_room_for_images({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'})
    False
    """
    here = Path.cwd() if folder is None else folder
    if any(name in environment for name in USER_SETTINGS) or any((here / name).exists() for name in USER_FILES):
        return False
    profile = resources.files('msgs_py') / 'transport_profiles' / 'fastdds.xml'
    environment['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
    return True
