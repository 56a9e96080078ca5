! Life: Conway's game on a torus, with one display a generation
ENTRY SUBROUTINE LIFE(CELLS, GENERATIONS)
  LOGICAL CELLS(,)
  INTEGER GENERATIONS
  INTEGER*1 ALIVE(*SIZE(CELLS, 1), *SIZE(CELLS, 2)), N(*SIZE(CELLS, 1), *SIZE(CELLS, 2))
  GEOMETRY(CYCLIC, CYCLIC)
  IMPLICIT NONE
  INTEGER I
  DO I = 1, GENERATIONS
    ALIVE = 0
    ALIVE(CELLS) = 1
!   the sum of three rows, then of three columns, less the cell itself
    N = ALIVE + ALIVE(+,) + ALIVE(-,)
    N = N + N(,+) + N(,-) - ALIVE
    CELLS = N .EQ. 3 .OR. (CELLS .AND. N .EQ. 2)
    CALL DISPLAY(CELLS)
  END DO
END
