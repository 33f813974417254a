"""Pictures of flights and studies."""
