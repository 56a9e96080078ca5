! CSG: walk a tree in reverse Polish order with a stack of entry and exit lists (thesis 4.8, appendix B)
ENTRY SUBROUTINE CSG(OPERATORS, OBJECTS, N, IN, OUT, LEAVES, TVALUE, OBJECT)
  IMPLICIT NONE
! OPERATORS(i): '0' for a primitive, or U, I, D; OBJECTS(i): which primitive; IN, OUT: where each ray enters and leaves
! each primitive (IN >= OUT: it misses); TVALUE: where it enters the whole, 1E30 if it misses; OBJECT: whose face that is
  INTEGER N, LEAVES, OBJECTS(N)
  CHARACTER OPERATORS(N)
  REAL IN(,,LEAVES), OUT(,,LEAVES), TVALUE(,)
  INTEGER*2 OBJECT(,)
! the boundaries of a list ascend, odd ones enter and even ones leave; 1E30 fills the rest
  REAL T(*SIZE(TVALUE, 1), *SIZE(TVALUE, 2), 2*LEAVES + 2, LEAVES + 1)
  INTEGER*2 WHOSE(*SIZE(TVALUE, 1), *SIZE(TVALUE, 2), 2*LEAVES + 2, LEAVES + 1)
  LOGICAL HIT(*SIZE(TVALUE, 1), *SIZE(TVALUE, 2))
  INTEGER LENGTHS(LEAVES + 1), I, K, SP
  SP = 0
  DO 100 I = 1, N
    IF (OPERATORS(I) .NE. '0') GOTO 10
    SP = SP + 1
    K = OBJECTS(I)
    HIT = IN(,,K) .LT. OUT(,,K)
    T(,,1,SP) = MERGE(IN(,,K), 1.0E30, HIT)
    T(,,2,SP) = MERGE(OUT(,,K), 1.0E30, HIT)
    WHOSE(,,1,SP) = K
    WHOSE(,,2,SP) = K
    LENGTHS(SP) = 2
    GOTO 100
10  CONTINUE
    CALL COMBINE(T, WHOSE, LENGTHS, 2*LEAVES + 2, LEAVES + 1, SP - 1, SP, OPERATORS(I))
    SP = SP - 1
100 CONTINUE
  TVALUE = T(,,1,1)
  OBJECT = WHOSE(,,1,1)
  OBJECT(TVALUE .GE. 1.0E30) = 0
END

! Combine the lists at LEFT and RIGHT of the stack into LEFT
SUBROUTINE COMBINE(T, WHOSE, LENGTHS, MOST, DEPTH, LEFT, RIGHT, OPERATOR)
  IMPLICIT NONE
  INTEGER MOST, DEPTH, LEFT, RIGHT, LENGTHS(DEPTH)
  REAL T(,,MOST,DEPTH)
  INTEGER*2 WHOSE(,,MOST,DEPTH)
  CHARACTER OPERATOR
  REAL A(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), SWAP(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER*2 W(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), WS(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER*2 COUNT(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL FROM(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2), MOST), FS(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL INL(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), INR(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL INSIDE(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2)), NOW(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  LOGICAL M(*SIZE(T(,,1,1), 1), *SIZE(T(,,1,1), 2))
  INTEGER I, J, K, TOTAL
! merge: the left list, then each boundary of the right one moved down to its place
  TOTAL = LENGTHS(LEFT) + LENGTHS(RIGHT)
  DO I = 1, LENGTHS(LEFT)
    A(,,I) = T(,,I,LEFT)
    W(,,I) = WHOSE(,,I,LEFT)
    FROM(,,I) = .TRUE.
  END DO
  DO I = 1, LENGTHS(RIGHT)
    K = LENGTHS(LEFT) + I
    A(,,K) = T(,,I,RIGHT)
    W(,,K) = WHOSE(,,I,RIGHT)
    FROM(,,K) = .FALSE.
    DO J = K, 2, -1
      M = A(,,J-1) .GT. A(,,J)
      IF (.NOT. ANY(M)) GOTO 20
      SWAP = A(,,J)
      A(M, J) = A(,,J-1)
      A(M, J-1) = SWAP
      WS = W(,,J)
      W(M, J) = W(,,J-1)
      W(M, J-1) = WS
      FS = FROM(,,J)
      FROM(M, J) = FROM(,,J-1)
      FROM(M, J-1) = FS
    END DO
20  CONTINUE
  END DO
! scan: a boundary stays where the combination changes between in and out
  INL = .FALSE.
  INR = .FALSE.
  INSIDE = .FALSE.
  COUNT = 0
  DO I = 1, TOTAL
    T(,,I,LEFT) = 1.0E30
    WHOSE(,,I,LEFT) = 0
  END DO
  DO 50 I = 1, TOTAL
    INL(FROM(,,I)) = .NOT. INL
    INR(.NOT. FROM(,,I)) = .NOT. INR
    IF (OPERATOR .EQ. 'U') NOW = INL .OR. INR
    IF (OPERATOR .EQ. 'I') NOW = INL .AND. INR
    IF (OPERATOR .EQ. 'D') NOW = INL .AND. .NOT. INR
    M = (NOW .NEQV. INSIDE) .AND. A(,,I) .LT. 1.0E30
    INSIDE = NOW
    COUNT(M) = COUNT + 1
    DO J = 1, I
      FS = M .AND. COUNT .EQ. J
      T(FS, J, LEFT) = A(,,I)
      WHOSE(FS, J, LEFT) = W(,,I)
    END DO
50 CONTINUE
  LENGTHS(LEFT) = MAXV(COUNT)
  IF (LENGTHS(LEFT) .LT. 2) LENGTHS(LEFT) = 2
END
