"""The laboratory: what runs many episodes, reports, draws and times them, and looks after the installation."""
