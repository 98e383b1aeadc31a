from .law import FoundLaw as FoundLaw, Law as Law
from .proposal import Proposal as Proposal
from .settings import ProposalSettings as ProposalSettings
