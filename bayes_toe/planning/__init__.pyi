from .adaptive import Adaptive as Adaptive
from .optimal import DesignGoal as DesignGoal
from .optimal import optimal_design as optimal_design
from .power import power as power
from .study_design import StudyDesign as StudyDesign
from .study_design import read_study_design as read_study_design
from .study_design import trial_list as trial_list
