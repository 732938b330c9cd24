"""Pictures drawn with matplotlib, without a display: one module per study or result that it draws."""
