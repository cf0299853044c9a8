"""Recording: a journal that grows while the bench runs, and the campaign files that are made from it."""

from shockrig.rig.recorder.campaign_folder import CampaignFolder
from shockrig.rig.recorder.files import write_run_files
from shockrig.rig.recorder.run_journal import Recorder, RecordingError, RunRecord, is_good, read_run, sample_time_s
from shockrig.rig.recorder.run_quality import judge
from shockrig.rig.recorder.state import CampaignState, SetAside, read_state

__all__ = [
    "CampaignFolder",
    "CampaignState",
    "Recorder",
    "RecordingError",
    "RunRecord",
    "SetAside",
    "is_good",
    "judge",
    "read_run",
    "read_state",
    "sample_time_s",
    "write_run_files",
]
