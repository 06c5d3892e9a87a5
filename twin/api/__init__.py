"""The Python interface, flat in `twin`: what the verbs of the command line call.

    import twin

    run = twin.fly("sads", "quaternion_pd", duration=60.0)
    print(run)
    diagnosis = twin.diagnose(run.recording)
    diagnosis.save("why.html")

Quantities are in SI units, angles in radians. A machine, a log or a law is given by its name or
path, or as the object. A result is printed by `print`, drawn by `.plot()` and written by
`.save(path)` (`twin.shown.Shown`), and holds NumPy arrays. Every user's mistake raises a
`TwinError` whose text is one sentence. `say` takes a line of progress at each step of what takes
long.

Each function imports what it needs when it is called, so that a verb loads no more than its job.
"""

from twin.api.campaigns import campaign as campaign
from twin.api.campaigns import fly_campaign as fly_campaign
from twin.api.campaigns import forecast as forecast
from twin.api.campaigns import replay as replay
from twin.api.campaigns import results as results
from twin.api.fits import compare as compare
from twin.api.fits import compare_sensors as compare_sensors
from twin.api.fits import diagnose as diagnose
from twin.api.fits import extend as extend
from twin.api.fits import identify as identify
from twin.api.fits import identify_by_all as identify_by_all
from twin.api.fits import transfer as transfer
from twin.api.fits import validate as validate
from twin.api.flights import BALANCING_DURATION as BALANCING_DURATION
from twin.api.flights import balance as balance
from twin.api.flights import fly as fly
from twin.api.inputs import check_log as check_log
from twin.api.inputs import import_log as import_log
from twin.api.inputs import imported as imported
from twin.api.inputs import load as load
from twin.api.inputs import machine_of as machine_of
from twin.api.inputs import new as new
from twin.api.inputs import read as read
from twin.api.inputs import show as show
