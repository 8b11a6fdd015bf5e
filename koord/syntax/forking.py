"""A lock for forking in processes with several threads.

A process that is forked while another thread is about to fork one keeps open what that one sends
on, so that nobody notices when it is gone. And whoever starts a process, or puts one away, asks the
system about all processes of this one, and may be told that one of another thread has ended.
"""

from __future__ import annotations

import threading

#: Held while a process starts, and while one is put away. The thread that forks holds it, and is
#: the only one of the new process, which may fork again.
FORKING = threading.RLock()
