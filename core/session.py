"""Where scripts come in, as in 0.1: `from kiriko.core.session import Session, finish`."""

from .solve.session import Session as Session
from .steps import finish as finish
