"""Public names and where they are at home; each is imported when it is first used."""

from .curves import least_reaction as least_reaction
from .curves import phase_degrees as phase_degrees
from .curves import plot_contact as plot_contact
from .curves import plot_curves as plot_curves
from .curves import plot_frequency_response as plot_frequency_response
from .curves import plot_phase as plot_phase
from .histories import plot_history as plot_history
from .loops import plot_loop as plot_loop
from .loops import plot_loops as plot_loops
from .sensors import plot_channel as plot_channel
from .sensors import plot_sensors as plot_sensors
