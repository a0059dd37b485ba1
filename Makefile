# Aliases of ./run for users of make.
demo test setup clean:
	./run $@
.PHONY: demo test setup clean
